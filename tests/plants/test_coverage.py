"""Every effect of every machine is compared with a plant that shares no code with it."""

from pathlib import Path

from exam.benches import PLACES, get_bench
from fieldmodels.registry import get_model, model_names


def test_every_effect_of_every_machine_is_compared():
    """The modules of this folder go through the effects that the exam's benches hide."""
    for name in model_names():
        assert {effect.name for effect in get_model(name).effects} == set(get_bench(name).effects), name
    assert {f"test_{kind}" for kind in PLACES.values()} <= {
        file.stem for file in Path(__file__).parent.glob("*")
    }

"""Beginning from a policy of the zoo: its actor's weights, and the statistics that it normalises by."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from stable_baselines3.common.running_mean_std import RunningMeanStd

from fieldagents.learned.run import Run
from fieldagents.policies.zoo import ZooError, get_entry


def begin(run: Run, afresh: bool) -> None:
    """Give a run the policy that its config begins from, and hold the observations' statistics.

    Args:
        run: Of a config with ``begin``; its seed says which of the entry's runs.
        afresh: Whether the run begins; a resumed one has its weights.

    Raises:
        ZooError: If its network is another one.
    """
    run.normaliser.training = False
    if not afresh:
        return
    config = run.config
    assert config.begin is not None
    training = get_entry(config.task, config.begin).nearest(config.environment.settings)
    load(run, training.policy(config.seed))


def load(run: Run, path: Path) -> None:
    """Give a run the actor and the normaliser of an exported policy."""
    arrays = {one.name: numpy_helper.to_array(one) for one in onnx.load(path).graph.initializer}
    own = dict(run.policy.named_parameters())
    given = {name.removeprefix("policy."): array for name, array in arrays.items() if "policy." in name}
    needed = {name for name in own if "value" not in name}
    if set(given) != needed or any(own[name].shape != array.shape for name, array in given.items()):
        raise ZooError(f"begin: {path.name} has another network than this config's")
    with torch.no_grad():
        for name, array in given.items():
            own[name].copy_(torch.tensor(array))
    statistics = cast(RunningMeanStd, run.normaliser.obs_rms)
    statistics.mean = np.array(arrays["mean"])
    statistics.var = np.square(arrays["scale"]) - run.normaliser.epsilon

"""What `__init__.py` imports where it is first used, for type checkers."""

from fieldagents.agent import Agent as Agent
from fieldagents.api import evaluate as evaluate
from fieldagents.api import reality as reality
from fieldagents.api import retune as retune
from fieldagents.api import train as train
from fieldagents.estimator import Diagnosis as Diagnosis
from fieldagents.estimator import diagnose as diagnose
from fieldagents.evaluation.agents import agent_names as agents
from fieldagents.logs import load as load
from fieldgym.bench import as_env as make_env
from fieldgym.sb3 import make_sb3_vec as make_sb3_vec
from fieldgym.settings import SettingsError as SettingsError
from fieldgym.task import BENCH as BENCH
from fieldgym.task import Task as Task
from fieldgym.tasks import TASKS as TASKS
from fieldgym.tasks import find_task as find_task
from fieldmodels import effects as effects
from fieldmodels.machine import Force as Force
from fieldmodels.machine import Machine as Machine
from fieldmodels.machine import number as number
from fieldmodels.model import Effect as Effect
from fieldmodels.model import Model as Model
from fieldmodels.model import Parameter as Parameter
from fieldmodels.model import Signal as Signal
from fieldmodels.recording import Recording as Recording
from fieldmodels.recording.datasets import dataset_names as datasets
from fieldmodels.recording.files import save_recording as save
from fieldmodels.registry import get_model as get_machine
from fieldmodels.registry import model_names as machines
from fieldmodels.synthesis import synthesise as synthesise

__all__ = [
    "Agent",
    "Diagnosis",
    "Effect",
    "Force",
    "Machine",
    "Model",
    "Parameter",
    "Recording",
    "Signal",
    "agents",
    "datasets",
    "diagnose",
    "effects",
    "evaluate",
    "get_machine",
    "load",
    "machines",
    "make_env",
    "make_sb3_vec",
    "number",
    "reality",
    "retune",
    "save",
    "synthesise",
    "tasks",
    "train",
]

def tasks() -> tuple[str, ...]: ...
def register() -> None: ...

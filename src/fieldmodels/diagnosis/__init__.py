"""What measured data say about a simulation: what is wrong, which cause, and what a remedy gains."""

from fieldmodels.diagnosis.procedure import diagnose
from fieldmodels.diagnosis.result import Cause, Diagnosis, Estimate, Verdict

__all__ = ["Cause", "Diagnosis", "Estimate", "Verdict", "diagnose"]

"""Pose reaching: a unicycle on a walled field, and what data say about a real one."""

MODEL = "model:PoseReaching"

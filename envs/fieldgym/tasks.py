"""The tasks that exist, by their one name on every floor."""

from __future__ import annotations

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any


@dataclass(frozen=True)
class Task:
    """A task as the floor above sees it.

    Attributes:
        name: Its name on every floor (physics, environment, agents, configs, tests).
        env_id: The identifier that ``gymnasium.make`` takes.
        entry_point: Where its environment is, ``module:class``.
        vector_entry_point: Where its native vector environment is.
        settings_class: Where the class of its settings is.
        model: Name of its model on the ground floor.
        title: Title for people.
        description: What is to be done, in one line.
        operator: Whether a human operator can take over, as in the source.
    """

    name: str
    env_id: str
    entry_point: str
    vector_entry_point: str
    settings_class: str
    model: str
    title: str
    description: str
    operator: bool = False

    @property
    def settings(self) -> type[Any]:
        """The class of its settings, imported when asked for."""
        found: type[Any] = resolve_name(self.settings_class)
        return found


TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        Task(
            name="excitation",
            env_id="fieldgym/Excitation-v0",
            entry_point="fieldgym.excitation:ExcitationEnv",
            vector_entry_point="fieldgym.excitation:ExcitationVectorEnv",
            settings_class="fieldgym.excitation:ExcitationSettings",
            model="excitation",
            title="Excitation",
            description="Shake a vehicle with its own arm so that its unknown parameters show.",
        ),
        Task(
            name="heel_strike",
            env_id="fieldgym/HeelStrike-v0",
            entry_point="fieldgym.heel_strike:HeelStrikeEnv",
            vector_entry_point="fieldgym.heel_strike:HeelStrikeVectorEnv",
            settings_class="fieldgym.heel_strike:HeelStrikeSettings",
            model="heel_strike",
            title="Heel strike",
            description="Choose a walking robot's estimator gains, stride by stride, under hidden noise.",
        ),
        Task(
            name="line_following",
            env_id="fieldgym/LineFollowing-v0",
            entry_point="fieldgym.line_following:LineFollowingEnv",
            vector_entry_point="fieldgym.line_following:LineFollowingVectorEnv",
            settings_class="fieldgym.line_following:LineFollowingSettings",
            model="line_following",
            title="Line following",
            description="Steer a biped along a taped line from the line's place in its camera.",
            operator=True,
        ),
        Task(
            name="line_following_pixels",
            env_id="fieldgym/LineFollowingPixels-v0",
            entry_point="fieldgym.line_following:LineFollowingPixelsEnv",
            vector_entry_point="fieldgym.line_following:LineFollowingPixelsVectorEnv",
            settings_class="fieldgym.line_following:LineFollowingSettings",
            model="line_following",
            title="Line following by pixels",
            description="Steer a biped along a taped line from its camera's image.",
            operator=True,
        ),
        Task(
            name="pose_reaching",
            env_id="fieldgym/PoseReaching-v0",
            entry_point="fieldgym.pose_reaching:PoseReachingEnv",
            vector_entry_point="fieldgym.pose_reaching:PoseReachingVectorEnv",
            settings_class="fieldgym.pose_reaching:PoseReachingSettings",
            model="pose_reaching",
            title="Pose reaching",
            description="Drive a unicycle to a ball and arrive with the right heading.",
        ),
        Task(
            name="uav_route",
            env_id="fieldgym/UavRoute-v0",
            entry_point="fieldgym.uav_route:UavRouteEnv",
            vector_entry_point="fieldgym.uav_route:UavRouteVectorEnv",
            settings_class="fieldgym.uav_route:UavRouteSettings",
            model="uav_route",
            title="UAV route",
            description="Fly to a goal past radars that see an aircraft's sides, leg by leg.",
        ),
    )
}

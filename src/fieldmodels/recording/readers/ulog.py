"""PX4's ULog (.ulg), by pyulog (extra ``px4``): every topic with its clock."""

from __future__ import annotations

import re
from pathlib import Path

from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable

_PLACE = r"(\w*local_position\w*|trajectory_setpoint)\."
_UNITS = {
    r".*timestamp(_sample)?": "us",
    rf"{_PLACE}([xyz]|position)": "m",
    rf"{_PLACE}(v[xyz]|velocity)|.*_m_s": "m/s",
    rf"{_PLACE}(a[xyz]|acceleration)|vehicle_acceleration\.xyz|sensor_accel\.[xyz]|.*_m_s2": "m/s^2",
    rf"{_PLACE}(yaw|heading)|vehicle_attitude_setpoint\.(roll|pitch|yaw)_body": "rad",
    rf"{_PLACE}yawspeed|vehicle_rates_setpoint\.(roll|pitch|yaw)|vehicle_attitude\.(roll|pitch|yaw)speed"
    r"|vehicle_angular_velocity\w*\.xyz|sensor_gyro\.[xyz]|sensor_combined\.gyro_rad": "rad/s",
    r"vehicle_angular_velocity\w*\.xyz_derivative": "rad/s^2",
    r"battery_status\.voltage_\w*v": "V",
    r"battery_status\.current_\w*a": "A",
}
"""A log states no units: these are of PX4's messages, https://github.com/PX4/PX4-Autopilot/tree/main/msg."""


def read(path: Path) -> SeriesTable:
    """Read all topics; a column is ``topic.field``, of a further instance ``topic[1].field``."""
    from pyulog import ULog

    result: dict[str, Series] = {}
    check_size(path, path.stat().st_size // 8, 1)
    with readable(path, "ULog"):
        for topic in ULog(str(path)).data_list:
            name = f"{topic.name}[{topic.multi_id}]" if topic.multi_id else topic.name
            for field, values in topic.data.items():
                if "_padding" not in field:
                    unit = _unit(f"{topic.name}.{field}")
                    result[f"{name}.{field}"] = Series.of(values, unit, f"{name}.timestamp")
    return SeriesTable(path, result)


def _unit(name: str) -> str:
    bare = re.sub(r"\[\d+\]", "", name)
    return next((unit for pattern, unit in _UNITS.items() if re.fullmatch(pattern, bare)), "")

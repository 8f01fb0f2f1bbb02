"""UAV route: waypoints of an aircraft under radars that can be shaken off, and what flight logs say."""

MODEL = "model:UavRoute"

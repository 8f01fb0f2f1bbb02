"""One axis with inertia, friction, a restoring force, an actuator and sensors."""

"""Line following: a biped with delayed steering, a camera and a taped line."""

MODEL = "model:LineFollowing"

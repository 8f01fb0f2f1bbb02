"""Line following: its agents, tuners and measures."""

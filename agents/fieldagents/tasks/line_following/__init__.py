"""Line following: its agents, tuners, figures and measures."""

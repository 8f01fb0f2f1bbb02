"""Line following by pixels: its agents, tuners, figures and measures."""

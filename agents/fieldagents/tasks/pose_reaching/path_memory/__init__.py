"""The path memory of chapter 5: new paths from remembered paths, as printed and as it works.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 5 ("the source" in this package).
"""

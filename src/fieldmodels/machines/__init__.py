"""The physics of every machine, one folder or file each: the tasks' and the benches'.

``fieldmodels.registry`` finds a machine's model by its name: in ``propeller_arm.py`` the class
``PropellerArm``; in a folder what ``MODEL`` of its ``__init__`` says, ``module:class``. A folder without it
is no machine of its own.
"""

"""The command line `bsp-planner`."""

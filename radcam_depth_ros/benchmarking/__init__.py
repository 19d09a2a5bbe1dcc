"""How fast a network is on this machine, stage by stage and whole, and against another form of it."""

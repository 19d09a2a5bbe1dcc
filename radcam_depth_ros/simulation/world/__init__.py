"""World: the road and its surroundings, traffic and the own vehicle."""

"""What is done with one drive: evaluate, replay, simulate it, or prepare its samples."""

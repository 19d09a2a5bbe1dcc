"""Objects: meshes of vehicles, people, animals, plants, buildings and street furniture."""

"""Materials: surfaces as each sensor sees them, and their textures."""

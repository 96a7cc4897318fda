"""Elements of any class in; what glass and parts tell, and what no model has. May import: root, rays, learning."""

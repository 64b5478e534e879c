"""How streams and runs look in a notebook."""

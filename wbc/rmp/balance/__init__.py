"""Balance laws of the reaction mass pendulum, one per file."""

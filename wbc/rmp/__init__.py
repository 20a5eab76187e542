"""The reaction mass pendulum, independent of robots."""

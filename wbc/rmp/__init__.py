"""The reaction mass pendulum itself; nothing here knows a robot."""

"""Free flight: turns of a robot that nothing holds and that has no momentum."""

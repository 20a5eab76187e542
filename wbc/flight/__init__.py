"""Free flight: turns of a robot without contacts and momentum."""

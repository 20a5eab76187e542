"""Robot models that come with the package."""

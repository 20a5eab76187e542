"""The layers of the live scene, each of which can be shown or hidden."""

"""What is drawn in the live scene, in layers that are shown or hidden each by itself."""

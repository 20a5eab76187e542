"""Unitree's humanoids and quadrupeds over DDS: messages, CRC, joint order, gains."""

from wbc.hardware.unitree.profiles import PROFILES, Profile, profile_named

__all__ = ["PROFILES", "Profile", "profile_named"]

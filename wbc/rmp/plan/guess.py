"""Where the search for a plan begins: straight from start to goal, flights as parabolas."""

from __future__ import annotations

import numpy as np

from wbc.rmp.plan.transcription import Transcription
from wbc.validate import Array


def first_guess(t: Transcription) -> Array:
    """Return scaled variables (n,): what is not given is taken from nominal, goal or start."""
    problem, layout = t.problem, t.layout
    first, last = _ends(t)
    middle = [sum(phase.durations) / 2.0 for phase in problem.schedule]
    whole = sum(middle)
    standing = sum(T for T, phase in zip(middle, problem.schedule, strict=True) if not phase.flies)
    w = np.zeros(layout.count)
    begun = 0.0
    for phase, places, T in zip(problem.schedule, layout.phases, middle, strict=True):
        w[places.duration] = T
        local = np.linspace(0.0, T, phase.intervals + 1)
        part = ((begun + local) / whole)[:, None]
        for name, where in places.states.items():
            w[where] = first[name] + part * (last[name] - first[name])
        w[places.states["com_velocity"]] = (last["com"] - first["com"]) / whole
        if phase.support is None:
            # On a parabola over the straight line.
            w[places.states["com"][:, 2]] += problem.gravity / 2.0 * local * (T - local)
            w[places.states["com_velocity"][:, 2]] += problem.gravity * (T / 2.0 - local)
        else:
            w[places.controls["cop"]] = np.mean(phase.support, axis=0)
            weight = problem.mass * problem.gravity * whole / standing
            w[places.controls["force"][:, 2]] = weight
        turns = w[places.states["orientation"]]
        w[places.inner] = (turns[:-1, None] + turns[1:, None]) / 2.0
        begun += T
    return np.clip(w / t.scale, t.lower, t.upper)


def _ends(t: Transcription) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the guessed first and last state by name."""
    problem = t.problem
    sources = [
        state.values(problem.mass) for state in (problem.start, problem.goal, problem.nominal)
    ]
    low, high = problem.limits_of(0).leg_length
    height = (low + high) / 2.0 if np.isfinite(high) else 1.0
    small, large = problem.limits_of(0).radius
    r = (small + large) / 2.0 if np.isfinite(large) else max(0.3 * height, small)
    default = {name: np.zeros(3) for name in t.layout.phases[0].states}
    default |= {"com": np.array((0.0, 0.0, height)), "radii": np.full(3, r)}
    supports = [np.mean(p.support, axis=0) for p in problem.schedule if p.support is not None]
    first, last = {}, {}
    for name in default:
        given = [source.get(name, (None,) * 3) for source in sources]
        first[name] = _filled((given[0], given[2], given[1]), default[name])
        last[name] = _filled((given[1], given[2], given[0]), default[name])
    for c in (0, 1):
        if supports and sources[0].get("com", (None,) * 3)[c] is None:
            first["com"][c] = supports[0][c]
        if problem.periodic is not None:
            last["com"][c] = first["com"][c] + problem.periodic[c]
        elif supports and sources[1].get("com", (None,) * 3)[c] is None:
            last["com"][c] = supports[-1][c]
    return first, last


def _filled(sources: tuple[tuple[float | None, ...], ...], default: Array) -> Array:
    """Return the first value given for each component, else the default."""
    out = default.copy()
    for c in range(3):
        for source in sources:
            if source[c] is not None:
                out[c] = source[c]
                break
    return out

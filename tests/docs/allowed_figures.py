"""Numbers with units on pages that nobody measured: by page why, and which.

A number that is measured does not belong here: name its command on the page, and keep what that
wrote (``page_figures.py``).
"""

# Pages whose figures are not held to files yet but for the claims of ``test_figures.py``.
OPEN = {
    "docs/howto/retarget.md": "recordings that are not ours to ship",
    "docs/howto/humans.md": "likewise",
}
CONDITIONS = "under what it was measured"
SHOWN = "what a picture shows, as its problem file sets it"
SETTINGS = "settings and defaults of the code"
ADVICE = "advice, examples and arithmetic"
ALLOWED: dict[str, dict[str, str]] = {
    "README.md": {
        CONDITIONS: "1.0 m/s; 2 ms; 4 ms; 6 degrees; 0.4; 2 cm; 0.3 m; 0.5 m/s; 100 N; 0.2 s",
    },
    "docs/contributing.md": {
        SETTINGS: "1.5 s",
        "versions": "3.10; 4.0; 1.26; 3.3; 1.15; 1.14",
    },
    "docs/experiments.md": {SHOWN: "65 %"},
    "docs/figures.md": {
        CONDITIONS: "1e-3 rad; 0.05 rad/s; 2 ms; 10 %; 5 ms; 10 mm; 1 ms; 500 Hz; 1.2 rad; 5 mm;"
        " 4 ms; 5 %; 0.25 ms; 0.8 m/s; 0.4; 0.5 m/s; 7 cm; 0, 45 and 90 degrees;"
        " 6 and 10 cm; 90 degrees; 6 degrees; 2 cm; 15 cm; 18, 12 and 12 s; 15 %",
        "what was wanted": "1.10 times",
        "omega T / (1 - exp(-omega T)) of a tenth of a second": "1.21",
        SETTINGS: "25 times",
    },
    "docs/gallery.md": {
        SHOWN: "90 degrees; 0.3 m; 18.5 N s; 20 mm; 0.6 s; 14 cm; 20 N s; 2 cm; 15 cm; 1.3;"
        " 6 degrees; 0.4; 14.6 N s",
    },
    "docs/guarantees.md": {
        SETTINGS: "1e-6 rad/s; 20 ms; 5 m/s^2; 1e8 m/s; 5 mm; 0.1 mm",
        "tolerances of the tests that are named": "1e-7; 1e-4",
    },
    "docs/howto/analyze.md": {"Rice's rate of crossings": "3.8; 6 s"},
    "docs/howto/benchmarks.md": {SETTINGS: "99.9 %"},
    "docs/howto/campaigns.md": {ADVICE: "720 runs"},
    "docs/howto/estimate.md": {
        SETTINGS: "4 ms; 10 ms; 0.12 m/s; 4 mm; 25 times; 100 times; 50 ms; 0.1 s;"
        " 3 m/s^2; 0.35 rad",
        ADVICE: "0.03; 0.003 rad/s; 500 Hz; 0.02 m/s^2; 0.12 degrees",
        CONDITIONS: "2 cm; 25 to 250 ms",
    },
    "docs/howto/failed-tick.md": {ADVICE: "20 ms"},
    "docs/howto/hardware.md": {
        SETTINGS: "2 ms; 10 s; 1 s; 1.5 s; 17 ms; 6 N s; 2 degrees; 6; 20; 100; 200",
        "what was wanted": "0.999",
        ADVICE: "20 s; 13 ms; 60 s",
    },
    "docs/howto/in-the-air.md": {SHOWN: "90 degrees; 0.3 m; 4 rad/s; 0.10 s"},
    "docs/howto/look.md": {SHOWN: "1.9 times; 31 N", SETTINGS: "25 times"},
    "docs/howto/own-constraint.md": {SETTINGS: "20 m/s^2"},
    "docs/howto/own-robot.md": {
        SETTINGS: "30 degrees; 20 m; 1 kg m^2", CONDITIONS: "10 s; 0.3 M omega d",
    },
    "docs/howto/plans-on-humanoid.md": {ADVICE: "30 kg; 0.1 s", SETTINGS: "1 %; 5 cm; 15 %"},
    "docs/howto/torque-loop.md": {SETTINGS: "0.1 s; 2 cm; 4 cm; 3 cm; 0.6"},
    "docs/howto/tuning.md": {
        SETTINGS: "1e-6; 1e-3; 1e-2; 10 rad/s",
        ADVICE: "0.01; 1 %; 5 ms; 0.5; 7 ms; 0.05; 100 ms; 0.02; 0.2; 1e-3; 1e-1; 2 ms",
        CONDITIONS: "15 cm; 7.5 s",
    },
    "docs/howto/walk.md": {
        SHOWN: "0.5 m/s; 15 cm; 36 cm; 1.3; 2 cm; 20 N s", SETTINGS: "0.9; 3 %",
    },
    "docs/howto/without-python.md": {SETTINGS: "1e-9; 1e-12"},
    "docs/peers.md": {ADVICE: "3 cm; 0.5"},
    "docs/pendulum.md": {
        CONDITIONS: "35 kg; 0.7 m; 20 cm; 30 cm; 50 N m; 0.6 rad",
        "M omega a millimetre": "0.13 N s",
    },
    "docs/reference/robot-files.md": {SETTINGS: "1e-9; 90 degrees; 9.81 m/s^2; 1e-9 m"},
    "docs/their-issues.md": {"theirs": "1.3e-4"},
    "docs/theory/control.md": {ADVICE: "0.1 rad/s; 15 rad/s²"},
    "docs/theory/errata.md": {
        "tolerance of the tests": "1e-9",
        "the paper's equations and sections": "4.1; 4.2; 8.1",
        ADVICE: "10.0 kg; 7.16 kg",
    },
    "docs/theory/index.md": {"tolerance of the tests": "6e-10"},
    "docs/theory/pendulum.md": {CONDITIONS: "35 kg; 0.7 m; 20 cm; 50 N m; 0.6 rad"},
    "docs/tutorial.md": {ADVICE: "1 cm; 60 %; 7 kg; 80 N; 0.1 s"},
}  # fmt: skip

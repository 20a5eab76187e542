"""What the page of recorded humans claims, and where the files have it; see test_figures.py."""

from tests.docs.from_files import Figures, both, from_json

HUMAN = "against_plates", "without_static_trial"
HUMANS: dict[str, tuple[str, str, Figures]] = {
    "a human's markers": (
        "docs/howto/humans.md",
        "| markers, rms | {} mm |",
        from_json("human_walk.json", "{:.1f}", "markers_mm"),
    ),
    **{
        name: (
            "docs/howto/humans.md",
            f"| {name} | {{}} {unit} | {{}} {unit} |",
            from_json("human_walk.json", form, *(f"{one}/{key}" for one in HUMAN)),
        )
        for name, unit, form, key in (
            ("vertical force, rms by its peak", "%", "{:.1f}", "vertical_percent_of_peak"),
            ("horizontal force, rms by its peak", "%", "{:.1f}", "horizontal_percent_of_peak"),
            ("CoP in single support, rms", "mm", "{:.0f}", "cop_single_mm"),
            ("CoP in double support, rms", "mm", "{:.0f}", "cop_double_mm"),
            ("all of these together", "%", "{:.1f}", "within_all_bands_percent"),
        )
    },
    "a human's horizontal force and CoP by markers alone": (
        "docs/howto/humans.md",
        "By markers alone the horizontal force is {} % off, the CoP {} and {} mm.",
        both(
            *(
                from_json("human_walk.json", form, f"by_markers_alone/{key}")
                for form, key in (
                    ("{:.1f}", "horizontal_percent_of_peak"),
                    ("{:.0f}", "cop_single_mm"),
                    ("{:.0f}", "cop_double_mm"),
                )
            )
        ),
    ),
    **{
        f"others' {key}": (
            "docs/howto/humans.md",
            f"| {f'{{}} {unit} | ' * 4}{wanted} {unit} |",
            from_json(
                "human_walks.json",
                form,
                *(f"{half}/{key}/{k}" for half in ("chosen on", "others") for k in range(2)),
            ),
        )
        for key, unit, form, wanted in (
            ("horizontal_percent_of_peak", "%", "{:.1f}", "12"),
            ("cop_single_mm", "mm", "{:.0f}", "25"),
            ("cop_double_mm", "mm", "{:.0f}", "35"),
            ("within_all_bands_percent", "%", "{:.0f}", "90 to 98"),
        )
    },
    "a second human's markers, forces and CoP": (
        "docs/howto/humans.md",
        "markers {} mm; vertical force {} %, horizontal {} %; CoP {} mm in single and {} mm in"
        " double support; {} % within the bands",
        both(
            from_json(
                "human_walk_treadmill.json",
                "{:.1f}",
                "markers_mm",
                "against_plates/vertical_percent_of_peak",
                "against_plates/horizontal_percent_of_peak",
            ),
            from_json(
                "human_walk_treadmill.json",
                "{:.0f}",
                "against_plates/cop_single_mm",
                "against_plates/cop_double_mm",
            ),
            from_json(
                "human_walk_treadmill.json", "{:.1f}", "against_plates/within_all_bands_percent"
            ),
        ),
    ),
}

"""One colour for each week, the same on plans and on the page: from dark to light, so that greys tell the order."""

# The map viridis of matplotlib from 0.12 to 0.95, by S. van der Walt and N. Smith, 2015 (CC0), in ten steps.
RAMP = (
    "#472a7a", "#3f4788", "#34608d", "#2a778e", "#218e8d", "#20a386", "#38b977", "#65cb5e", "#a0da39", "#dfe318",
)  # fmt: skip


def colour_of(week: int, weeks: int) -> str:
    """The colour of a week of so many, between those of RAMP, as #rrggbb."""
    place = (len(RAMP) - 1) * (week / (weeks - 1) if weeks > 1 else 0.0)
    first = min(int(place), len(RAMP) - 2)
    ends = [[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in RAMP[first : first + 2]]
    mixed = [round(a + (place - first) * (b - a)) for a, b in zip(*ends, strict=True)]
    return "#" + "".join(f"{value:02x}" for value in mixed)

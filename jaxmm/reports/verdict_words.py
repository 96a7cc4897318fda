"""What the verdicts and the evidence mean, in plain words: every report, page and figure takes them from here."""

from collections.abc import Sequence

from jaxmm.verdicts.verdicts import (
    DISPLACED,
    LEAST_OF_REMOVED,
    OCCLUDED,
    PRESENT,
    REMOVED,
    SURELY,
    UNSCANNED,
    VerdictSettings,
)

VERDICT_WORDS: dict[str, str] = {
    PRESENT: "The scan met the element where the model has it.",
    DISPLACED: (
        "The element stands, but off the place that the model gives it: by more than its tolerance, and by more than "
        "the measurement leaves open."
    ),
    REMOVED: "The scan looked through the place where the model has the element: it is not there any more.",
    OCCLUDED: (
        "The scanner was turned to the element, but other things stood in between, the rays toward it brought nothing "
        "back, or too little of it was met to tell. It may be there or not: look again, from the proposed viewpoint "
        "where there is one."
    ),
    UNSCANNED: (
        "As the model has it, no ray that is known would reach the element, or tell it from another that shares its "
        "surface: it is out of view or range, or behind other parts of the building. Without --sensor, the view is "
        "what the points of the scan span, and rays that its file tells to have brought nothing back. Nothing is said "
        "of it."
    ),
}
# Why an element is occluded, by what became of its rays.
NOTHING_BACK = "rays went there and brought nothing back"
IN_FRONT = "other things stood in front"
PASSES = "rays pass, as through glass or an open door"
LEFT_OPEN = "too few rays tell of it, or some pass where others end"
# Of a place of the model, in the order of evidence.FRACTIONS.
EVIDENCE_WORDS: dict[str, str] = {
    "through": "Rays passed through this place of the model and met something behind it: nothing stands here.",
    "support": "Rays ended here, where the model has a surface.",
    "blocked": "Rays ended before this place: something stands in front of it.",
    "unseen": "No ray that came back passed here.",
}
# The same four, of a point that the robot measured.
ROBOT_EVIDENCE_WORDS: dict[str, str] = {
    "through": "Measured behind a surface of the model: the ray passed through it.",
    "support": "Measured on a surface of the model.",
    "blocked": "Measured in front of the model's surface: the model does not have this thing, which may be furniture.",
    "unseen": "Measured where the model has nothing along the ray.",
}
PROBABILITY_OF_MISMATCH = "The probability of a mismatch is that it is real."
PROBABILITY_WORDS = f"{PROBABILITY_OF_MISMATCH} That of an element is that it was removed, whatever its verdict."
SURE_OF_TYPE = 0.95  # probability of its type, below which an object is told to be of the other one, perhaps
OTHER_TYPE_WORDS = "A second type, and its probability: what is seen of the object leaves open which of both it is."
ASSUMED = "~"
ASSUMED_WORDS = f"{ASSUMED} before a size: not seen from end to end, but assumed."
OBSERVABLE_WORDS = (
    "The observable share of an object is how much of it the scan could tell of, out of all that would be seen of it "
    "if it stood alone in the field of view."
)
UNEXPLAINED_WORDS = (
    "Something that is not in the model, and neither a new wall nor a new column: furniture, a machine, a stair, an "
    "open door. Each box holds points that hang together and lie apart from the model; nothing says what it is."
)


def why_occluded(rays: Sequence[int]) -> str:
    """Why nobody knows of an element that was in view, by its rays (4,) in the order of evidence.FRACTIONS."""
    through, support, blocked, unseen = rays
    if through + support >= max(blocked, unseen):
        passes = through >= max(SURELY * VerdictSettings().least_rays, LEAST_OF_REMOVED * (through + support))
        return PASSES if passes else LEFT_OPEN
    return NOTHING_BACK if unseen > blocked else IN_FRONT

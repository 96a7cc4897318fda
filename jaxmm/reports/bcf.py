"""What was found as topics of BCF (BIM Collaboration Format) 3.0 or 2.1, which BIM tools open.

bcf.version, project.bcfp and extensions.xml (2.1: extensions.xsd); then a folder per topic with markup.bcf (what is
said), viewpoint.bcfv (where to look from, and at what) and snapshot.png. Coordinates are those of the prior: metres,
z up, at full precision.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from jaxmm.files import write_atomically
from jaxmm.inputs import InputError
from jaxmm.reports.archives import write_zip
from jaxmm.reports.bcf_displaced import displaced_topics
from jaxmm.reports.bcf_layouts import LAYOUTS, head, markup, viewpoint, xml
from jaxmm.reports.bcf_others import removed_topics, thing_topics
from jaxmm.reports.bcf_overview import overview_topic
from jaxmm.reports.bcf_request import VERSIONS, NewElement
from jaxmm.reports.bcf_topics import topics_of
from jaxmm.verdicts.results import Detection


def write_bcf(
    path: Path,
    detection: Detection,
    project: str = "jaxmm",
    when: datetime | None = None,
    *,
    version: str = VERSIONS[0],
    new: Mapping[int, NewElement] | None = None,
) -> None:
    """Write mismatches.bcf, whole or not at all: one topic per mismatch, displaced or removed element, or none.

    What is not in the model comes last, see `bcf_others.thing_topics`. Two topics or more come behind one about all of
    them. The topics' GUIDs follow from the project and from what changed where, so a second run names the same mismatch
    the same, and equal arguments give equal bytes.

    Args:
        path: the file.
        detection: what was found; its scans tell where to look from.
        project: name of the project that the topics belong to.
        when: date of all topics, by default now; one without a time zone is UTC.
        version: of BCF, one of VERSIONS.
        new: GlobalIds that the updated model has for added objects, by their place among the mismatches.

    Raises:
        InputError: an unknown version.
        ValueError: there is something to tell of, but no scan.
        OSError: it cannot be written; the path stays as it was.
    """
    if version not in LAYOUTS:
        raise InputError(f"BCF: expected version {' or '.join(VERSIONS)}, got {version!r}")
    when = when or datetime.now(UTC)
    when = when.replace(tzinfo=UTC) if when.tzinfo is None else when.astimezone(UTC)
    layout = LAYOUTS[version]
    topics = (
        *topics_of(detection, project, new), *removed_topics(detection, project),
        *displaced_topics(detection, project), *thing_topics(detection, project),
    )  # fmt: skip
    files = head(layout, project)
    for number, topic in enumerate((*overview_topic(detection, project, topics), *topics)):
        files[f"{topic.guid}/"] = b""  # readers rely on folders being listed
        files[f"{topic.guid}/markup.bcf"] = xml(markup(layout, topic, number, when))
        files[f"{topic.guid}/viewpoint.bcfv"] = xml(viewpoint(layout, topic))
        files[f"{topic.guid}/snapshot.png"] = topic.picture(detection.drawing)
    write_atomically(Path(path), lambda temporary: write_zip(temporary, files))

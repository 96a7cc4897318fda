"""Python libraries that read our topics and models, each in a process of its own, in whatever environment has them.

    python -m benchmarks.clients.model_readers NAME FILE VERSION     what one reads, as JSON

Nothing here imports jaxmm.
"""

import importlib
import json
import sys
from pathlib import Path
from typing import Any


def bcf_client(path: Path, version: str) -> list[dict[str, Any]]:
    """The topics of a BCF file: title, camera [m], and what each selects."""
    read = importlib.import_module(f"bcf.v{version[0]}.bcfxml").BcfXml.load(path)
    topics = []
    for topic in read.topics.values():
        (view,) = topic.viewpoints.values()
        info = view.visualization_info
        at, selection = info.perspective_camera.camera_view_point, info.components.selection
        chosen = [one.ifc_guid for one in selection.component] if selection else []
        topics.append({"title": topic.topic.title, "camera": [at.x, at.y, at.z], "selected": chosen})
    return topics


def ifctester(path: Path, version: str) -> dict[str, int]:
    """Whether a rule about our marks holds: what has a verdict has a probability."""
    import ifcopenshell
    from ifctester import ids

    rule = ids.Specification(name="marks")
    rule.applicability.append(ids.Property(propertySet="jaxmm_Verdict", baseName="Verdict"))
    rule.requirements.append(ids.Property(propertySet="jaxmm_Verdict", baseName="Probability"))
    rules = ids.Ids(title="marks")
    rules.specifications.append(rule)
    rules.validate(ifcopenshell.open(str(path)))
    return {"verdicts": len(rule.applicable_entities), "probabilities": len(rule.passed_entities)}


READERS = {"bcf-client": bcf_client, "ifctester": ifctester}


if __name__ == "__main__":
    name, path, version = sys.argv[1:]
    try:
        answer = READERS[name](Path(path), version)
    except ImportError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from error
    print(json.dumps(answer))

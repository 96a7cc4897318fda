"""The whole paper in stages: all rows of Table I, semi-real buildings, ablations, scaling, sweeps, the thesis's scans.

The run folder, for those who read it (figure scripts read and never train):

    config.toml, versions.json          settings and code of the last command
    table_1.json|csv|md                 54 rows of the thesis, then sensor noise; IFC files of JAXMM_DATA behind them
    label_noise.json|csv|md             trained on true and on heuristic labels
    studies.json|csv|md                 curves: training rooms, furniture, range noise, misalignment
    thesis_scans.json|csv|md            the thesis's released scans, where JAXMM_DATA holds them
    stages/clouds/data/*.npz            training and validation clouds (pipeline.cached_clouds)
    stages/models/, models_1/ ...       models.safetensors, entries.json, metrics.jsonl of each seed (paper_models)
    stages/evidence_clouds/, evidence_1/ ...   further trainings of `evidence` (paper_evidence_models)
    stages/rooms/<set>/                 rooms.json, example.npz of one set of test scenes (paper_scores)
    stages/files/<file>/                an IFC file of JAXMM_DATA: <set>.json
    stages/scaling_*/                   clouds, models and test rooms of the scaling study (paper_scaling)
    stages/sweeps/<study>_<level>/      <scenario>.json (paper_sweeps)
    stages/thesis_*/                    models trained on the thesis's rooms, and scores (paper_thesis)
    stages/*/stage.json                 what a stage was made of: settings, key of its code, versions, git commit

Every stage is cached by content (stages.py): the same command makes what is missing or no longer of the same settings
and code, and tables are always written anew.
"""

from pathlib import Path
from typing import Any

from jaxmm import run_folder
from jaxmm.config import Config
from jaxmm.files import load_json
from jaxmm.runs.paper.evidence_models import evidence_key, trained_evidence
from jaxmm.runs.paper.models import models_key, trained_networks
from jaxmm.runs.paper.rows import sets_of
from jaxmm.runs.paper.scaling import scaling_scores
from jaxmm.runs.paper.scores import default_judges, file_scores, scored_set
from jaxmm.runs.paper.sweeps import as_markdown as studies_as_markdown
from jaxmm.runs.paper.sweeps import study_rows, sweep_scores
from jaxmm.runs.paper.tables import (
    as_markdown,
    as_summary,
    file_rows,
    label_noise,
    not_best,
    table_1,
    trainings_told,
    write_table,
)
from jaxmm.runs.paper.thesis_scans import as_markdown as thesis_as_markdown
from jaxmm.runs.paper.thesis_scans import thesis_table
from jaxmm.runs.stages import STAGE, STAGES

ANY_CHANGE = "the greater of both kinds of change"  # of the probabilities of the models that ship
TOLD = ("step_count", "batch_size", "points_per_cloud", "learning_rate", "schedule")  # of the training, in the tables


def reproduce_paper(config: Config, folder: Path) -> None:
    """Make every stage that is missing, then all tables."""
    with run_folder.open_run(folder, config, staged=True):
        networks = trained_networks(config, folder)
        judges = default_judges(config, networks, trained_evidence(config, folder))
        judges = judges, f"{models_key(config)} {evidence_key(config)}".rstrip()
        scores = {scenes.name: scored_set(config, folder, scenes, rows, judges) for scenes, rows in sets_of().items()}
        files = file_scores(config, folder, judges)
        studies = study_rows(config, sweep_scores(config, folder, judges), scaling_scores(config, folder))
        thesis = thesis_table(config, folder)
        rows = write_tables(config, folder, scores, files)
        write_table(folder, "studies", studies, meta_of(config, folder), studies_as_markdown(studies))
        if thesis:
            write_table(folder, "thesis_scans", thesis, meta_of(config, folder), thesis_as_markdown(thesis))
    print(as_summary(rows))
    print(f"run folder: {folder}")


def write_tables(
    config: Config, folder: Path, scores: dict[str, list[dict[str, Any]]], files: dict[str, list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Write Table I, with the rows on IFC files behind it, and the ablation of labels; returns the former's rows."""
    rows = table_1(scores, config.evaluate) + file_rows(files, config.evaluate)
    meta = meta_of(config, folder) | {"trainings": trainings_told(), "not_best": not_best(rows)}
    write_table(folder, "table_1", rows, meta, as_markdown(rows))
    noise = label_noise(scores, config.evaluate)
    write_table(folder, "label_noise", noise, meta_of(config, folder), as_markdown(noise))
    return rows


def meta_of(config: Config, folder: Path) -> dict[str, Any]:
    """What stands beside every table: settings, versions, and the commit that made each stage."""
    stages = sorted((folder / STAGES).rglob(STAGE))
    commits = {str(path.parent.relative_to(folder / STAGES)): load_json(path)["versions"] for path in stages}
    return {
        "seed": config.seed,
        "test_seed": config.data.test_seed,
        "test_rooms_per_row": config.data.test_rooms,
        "least_positives": config.evaluate.least_positives,
        "interval": "95 % percentile bootstrap over rooms, over buildings where rooms are views of such",
        "trainings_per_network": config.paper.seeds,
        "further_trainings_of_evidence": config.paper.evidence_seeds,
        "evidence_ranks_by": ANY_CHANGE,
        "scan": config.scan.thawed(),
        "train": {name: getattr(config.train, name) for name in TOLD},
        "versions": load_json(folder / run_folder.VERSIONS),
        "stage_commits": {name: told["git_commit"] for name, told in commits.items()},
    }

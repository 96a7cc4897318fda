"""Scores as Markdown."""

from typing import Any

NAMES = {
    "roc_auc": "ROC AUC", "fpr_at_95": "FPR at 95 % recall", "iou_at_95": "IoU at 95 % recall", "ece": "ECE",
    "brier": "Brier", "precision": "precision", "recall": "recall", "coverage": "coverage", "risk": "risk",
    "aurc": "AURC", "unobservable_called_removed": "unobservable, called removed", "ap": "AP",
    "iou_positive": "IoU positive", "iou_negative": "IoU negative", "iou_static": "IoU static", "miou": "mean IoU",
}  # fmt: skip


def markdown(told: dict[str, Any]) -> str:
    """What `scores.score` found: a table for each part, one line for each difficulty."""
    lines = [f"{told['scenes']} scenes of the split {told['split']}; 95 % intervals over scenes."]
    for part in dict.fromkeys(row["part"] for row in told["rows"]):
        rows = [row for row in told["rows"] if row["part"] == part]
        metrics = list(dict.fromkeys(row["metric"] for row in rows))
        lines += ["", f"| {part} | scenes | {' | '.join(NAMES[name] for name in metrics)} |"]
        lines.append("| --- | --- |" + " --- |" * len(metrics))
        for difficulty in dict.fromkeys(row["difficulty"] for row in rows):
            own = {row["metric"]: row for row in rows if row["difficulty"] == difficulty}
            cells = [cell(own[name]) for name in metrics]
            lines.append(f"| {difficulty} | {own[metrics[0]]['scenes']} | {' | '.join(cells)} |")
    if told["risk_coverage"]:
        steps = ", ".join(f"{one['risk']:.4f} at {one['coverage']:.3f}" for one in told["risk_coverage"])
        lines += ["", f"Risk at coverage of the observable elements: {steps}."]
    return "\n".join(lines)


def cell(row: dict[str, Any]) -> str:
    """A value with its interval; "-" where there is nothing to tell."""
    if row["value"] is None:
        return "-"
    return f"{row['value']:.3f} ({row['interval'][0]:.3f} to {row['interval'][1]:.3f})"

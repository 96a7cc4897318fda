"""Labelled point clouds in; models, probabilities, boxes and scores out. May import: root, rays."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "batches": ["LabelledCloud"],
        "boxes": ["Box", "fit_boxes"],
        "metrics": ["point_metrics"],
        "model_files": ["load_models", "save_models"],
        "prediction": ["Judges", "judge", "read_judges"],
        "preprocess": ["voxel_downsample"],
        "torch_weights": ["read_state_dict"],
    },
)

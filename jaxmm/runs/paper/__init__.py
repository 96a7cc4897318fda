"""The rows of the whole paper: which scenes, which models, which tables. A part of the room runs."""

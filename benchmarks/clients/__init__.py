"""Other programs, asked what they read in the files that jaxmm writes."""

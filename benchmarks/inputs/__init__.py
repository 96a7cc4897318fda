"""What benchmarks make to run on, where no file will do."""

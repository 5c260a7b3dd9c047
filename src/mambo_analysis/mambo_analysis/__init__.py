"""What recordings say: comparisons, importers of other formats, identification."""

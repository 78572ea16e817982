"""What all rooms use: errors, files, progress, options, processes, and how results show themselves."""

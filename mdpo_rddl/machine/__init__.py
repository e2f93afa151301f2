"""What the machine gives: processes, cores, memory, files, clusters, versions."""

"""Made data of the benchmarks: performances of captured motion, cameras, rooms, detectors."""

"""Cases with known answers, and the benchmark."""

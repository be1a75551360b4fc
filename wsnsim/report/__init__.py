"""One self-contained HTML page of results: summary, figures, scenario, provenance, and a replay."""

"""The source papers: what each prints and claims (a YAML file), its own measures and its figures (a package)."""

"""The plug-ins that `wsnsim new --for ROLE NAME` writes: a module and a scenario for each role, complete and checked.

They are ordinary modules of the package, so that types, style and tests hold for what users start from. `plugin_name`
and `Plugin...` stand for the names that the user chooses.
"""

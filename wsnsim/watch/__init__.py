"""Runs and campaigns seen live in a browser, from a server on this machine that takes nothing and opens no file.

with RunView(title) as view: experiment.run(scenario, out=path, progress=view.report, watched=view.recorder)
with CampaignView(folder) as view: view.wait()
"""

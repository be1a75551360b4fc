"""Runs, campaigns and results seen in a browser, from a server on this machine that takes nothing and opens no file.

with RunView(title) as view: experiment.run(scenario, out=path, progress=view.reporting(print), watched=view.recorder)
with CampaignView(folder) as view, view.following(): run_campaign(folder, engine)
with page_server(page) as server: print(server.url)
"""

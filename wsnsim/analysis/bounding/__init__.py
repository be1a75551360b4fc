"""How bounds on the tracking error come about: what was drawn, what readings tell, and what is left of the doubt."""

"""Files become answers. pandas and matplotlib live here."""

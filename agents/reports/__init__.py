"""What a run looks like: one HTML file that needs nothing but a browser.

To be read in this order: `report` puts the page together from `charts`, from episodes that `recording` keeps for its
player, and from the page, style and script in `templates`.
"""

"""What somebody in front of a browser sees: how old a picture is, and a page that stays open."""

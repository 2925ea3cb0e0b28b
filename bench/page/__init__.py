"""Dashboard in a browser: age of the images, and a page that stays open."""

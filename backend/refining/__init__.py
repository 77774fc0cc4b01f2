"""Better coordinates for what was clicked: by the picture's registration to the map, and by later fixes."""

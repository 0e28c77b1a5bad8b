"""Published observers, cameras, lights and charts, as tables of our own."""

"""The window's widgets, which show what the presenters hold and forward what the user does."""

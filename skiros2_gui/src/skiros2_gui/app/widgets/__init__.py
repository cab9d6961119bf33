"""The main widget, its status line and error bar, the theme."""

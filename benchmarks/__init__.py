"""How fast it is: everything that ``./bench`` runs side by side."""

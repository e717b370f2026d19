"""Learning curves of many runs: reading them, their statistics, figures and tables (`plot_curves.py`)."""

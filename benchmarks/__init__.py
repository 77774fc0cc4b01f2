"""The budgets of the design, measured by a command."""

"""Mission plans: their files, and what is done with them and a vehicle."""

"""What a study of twins is made of: the twins that are looked at."""

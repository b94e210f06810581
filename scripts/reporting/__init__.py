"""What pages and tables for people are made of: statistics, sentences, pictures, templates."""

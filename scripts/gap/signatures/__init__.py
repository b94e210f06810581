"""What photographs of a board show besides where points lie: signs of each, fitted, compared, and what they cannot tell."""

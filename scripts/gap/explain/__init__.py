"""What a verdict's reader asks next: where the twin fails, what each step brought, where to capture next."""

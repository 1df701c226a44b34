"""What a comparison writes: tables, their summary, and plots."""

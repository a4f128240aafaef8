"""Tables, figures and pages. Only this package draws."""

"""Reports: tables, figures and HTML pages. The only package that draws."""

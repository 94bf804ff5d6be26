"""Makes the report of a study: one HTML file that needs no network, and its figures as SVG and PNG files."""

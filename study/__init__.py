"""Repeats the comparison of Serpa and Rodrigues: plans and runs simulations, and makes a page of the results."""

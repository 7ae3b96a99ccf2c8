"""What measured and computed numbers may be: one table of rules, and their tests on runs, frames and rigs."""

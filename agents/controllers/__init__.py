"""Who acts: a controller chooses the actions of many episodes that run side by side.

To be read in this order: `view` is what a controller sees, `controller` what it must do, `table` which there are and
what they are called. One file each: `random`, `resolved_rate`, `trained`.
"""

"""What is to be learnt, and what is kept of it.

To be read in this order: `config` is one experiment, as a YAML file describes it; `runs` is the folder of a training
run; `training` leads from the one to the other.
"""

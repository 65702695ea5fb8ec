"""Learning on the environments of `pcm_gym`, in rooms that import only what stands before them here.

`learners` learn, `controllers` act, `experiments` say what is to be learnt and keep it, `evaluation` judges, `reports`
show it, and `commands` are how all of it is asked for. What can be chosen by name stands in one table each:
`learners.algorithms` and `controllers.table`.
"""

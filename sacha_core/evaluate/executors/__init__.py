"""Where many independent jobs are worked off: processes of this machine, or a Ray cluster.

All executors have one interface, `jobs.Executor`; a new one is a new file here.
"""

"""What fast code here runs on: a few threads that share out jobs, memory that is used again, and vectors of sixteen lanes."""

"""What lets a test know its answer: copies, classes that something else gives away, and roles that overlap."""

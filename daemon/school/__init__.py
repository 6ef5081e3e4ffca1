"""What teaching rests on: whether a part was shown well enough, and parts taught from their drawings."""

"""The arms of `auto`: ways to find a policy, one to a file, behind the interface of `base`."""

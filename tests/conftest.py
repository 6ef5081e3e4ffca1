"""What all tests share: how hypothesis behaves. An example has no deadline: machines that test are often busy."""

from hypothesis import settings

settings.register_profile("busy machine", deadline=None)
settings.load_profile("busy machine")

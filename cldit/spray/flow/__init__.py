"""The spray that is computed: an injector's droplets in a gas that they drag along and cool."""

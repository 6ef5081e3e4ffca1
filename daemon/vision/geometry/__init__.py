"""Cameras, rays, planes, polygons, rigid fits, as arrays. No pixel is read, nothing has a name."""

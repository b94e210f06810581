"""What has changed between two sets of captures by one camera."""

"""The rig, its cameras and campaigns: geometry and tables, without Blender and without images' contents."""

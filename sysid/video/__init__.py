"""Parts of `sysid.video_roll`: decoding, what is tracked, the camera, and the angle."""

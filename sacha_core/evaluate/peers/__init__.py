"""Other people's codecs, one file each, on the avatars that ours is measured on."""

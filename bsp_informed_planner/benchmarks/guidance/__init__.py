"""What learned guidance of an arm is worth, beside controls that know less."""

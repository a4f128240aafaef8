"""Fits of elastic laws to tests of material coupons."""

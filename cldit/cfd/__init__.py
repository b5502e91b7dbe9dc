"""Importers: results of CFD programs as sprays."""

"""The paper reproduced: every table and figure of Steinbauer & Bischof (2004) beside this package's."""
